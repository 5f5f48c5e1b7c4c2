"""What people and devices write, read strictly and shown safely; files written whole."""
