"""What everything is said in: controllers, plants, their responses, margins and stability."""
