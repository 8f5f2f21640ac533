"""Plants that are known by measured frequency responses: curves, families, loops, their crossings and stability."""
