"""Files, tables, units, names and progress: what every room needs and no room owns."""
