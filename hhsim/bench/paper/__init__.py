"""The paper's whole evaluation."""
