"""Rival estimators."""
