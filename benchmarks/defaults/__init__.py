"""The shortest body file against CalculiX, on bodies that no demo is like."""
