"""Error against cost of all models of a body: tried, recorded, drawn."""
