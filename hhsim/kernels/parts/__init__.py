"""Things of several rigid parts whose joints move as recorded: their surface, and ticks of a hand that gives way."""
