"""The gloves that there are, one file each: what a glove is called, what can be set, and where its driver is."""
