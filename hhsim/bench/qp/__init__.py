"""Programs of real ticks, solved by every installed solver."""
