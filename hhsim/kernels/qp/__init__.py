"""Active-set solver of quadratic programs."""
