"""The worst cases of gains over a family, or over each member of a list of plants."""
