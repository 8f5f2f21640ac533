"""`model: fractional`:  its record, and what a spec with such a plant cannot ask for."""
