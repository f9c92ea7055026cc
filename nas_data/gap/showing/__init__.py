"""Pictures and page of a gap report, from its files alone."""
