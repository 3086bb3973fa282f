"""Gloves: one driver each, and the watch over their samples."""
