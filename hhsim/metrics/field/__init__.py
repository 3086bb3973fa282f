"""Figures of repaired recordings as the field publishes them; every module says where its definition comes from."""
