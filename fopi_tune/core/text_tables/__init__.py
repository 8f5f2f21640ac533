"""Tables of numbers in the texts of files."""
