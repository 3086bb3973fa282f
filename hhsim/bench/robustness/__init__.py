"""Hard cases, random targets and recordings: what a method must survive."""
