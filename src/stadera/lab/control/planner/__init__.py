"""Plans of footholds and of the centre of mass."""
