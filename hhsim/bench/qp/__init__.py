"""The programs of real ticks, solved by every solver at hand."""
