"""Controllers, plants and loops: their responses, margins, peaks and stability, in NumPy."""
