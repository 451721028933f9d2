"""Error against cost: scenes, chart, fit, stability."""
