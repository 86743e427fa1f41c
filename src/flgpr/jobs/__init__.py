"""Running a method: here, on several processes or a cluster, in sections, and on after a stop."""
