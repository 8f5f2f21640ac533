"""Results that were read from files."""
