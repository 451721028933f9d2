"""From a reduced body and a method to the program that the core runs."""
