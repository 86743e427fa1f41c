"""Slow, obvious twins of fast routines, written from the papers' equations."""
