"""The engine: recipes, passes, and the chain that every recipe is made of."""
