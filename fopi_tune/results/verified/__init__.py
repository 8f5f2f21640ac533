"""What results say of a verification."""
