"""The commands of the program `nas`: the file `a_b.py` is the command `nas a b`."""
