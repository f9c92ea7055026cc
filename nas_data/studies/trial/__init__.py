"""Trial of the names on an arm: known changes are made one at a time, recorded, and named blind."""
