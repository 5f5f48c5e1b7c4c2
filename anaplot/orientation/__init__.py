"""One model and one strip: relative orientation with scale transfer, its table, point patterns."""
