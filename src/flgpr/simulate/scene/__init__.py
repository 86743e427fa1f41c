"""What a scene holds: its file, its drawn world, random numbers by name and place."""
