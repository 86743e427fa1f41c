"""From a run to a result folder: recipes, stage order, reports."""
