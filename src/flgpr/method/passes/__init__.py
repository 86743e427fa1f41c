"""The passes of the method, a class and a file each: what is gathered scan by scan."""
