"""What the JSON of results holds, as types, and the JSON Schema that is made of them."""
