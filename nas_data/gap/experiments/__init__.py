"""Next experiment to record, if the data cannot distinguish two names."""
