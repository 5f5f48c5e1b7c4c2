"""Charts: numbers in, a drawing out."""
