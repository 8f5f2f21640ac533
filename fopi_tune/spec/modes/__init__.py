"""The section `system` of a system file:  which two modes there are, and when they take turns."""
