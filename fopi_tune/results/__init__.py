"""What stages hand on and people get, as frozen data with their JSON."""
