"""The passes of the method, a class and a file each: what is gathered of all scans, one after the other."""
