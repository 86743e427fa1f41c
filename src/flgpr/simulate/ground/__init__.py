"""The ground: soil, surface, terrain and what lies in it, as scatterers and as media."""
