"""A recorded hand and its repair: both beside the object, the figures of the field, their table and its verdict."""
