"""One tick: the graphic hand that a method makes of the user's, and the forces."""
