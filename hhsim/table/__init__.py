"""Tables of figures: columns with units, and their text for a terminal and for files."""
