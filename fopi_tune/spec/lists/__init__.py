"""Lists of plants in a spec: how `plants:` is read, and the specs of its members alone."""
