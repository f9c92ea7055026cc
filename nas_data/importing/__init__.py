"""Import of recorded logs: the map, the file formats, units, joining, audits and resampling."""
