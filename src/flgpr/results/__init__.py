"""Result folders, their scores, and the files that the viewer reads."""
