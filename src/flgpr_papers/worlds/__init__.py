map_worlds=None
