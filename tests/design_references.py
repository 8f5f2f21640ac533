REFERENCES: dict[str, float] = {}
