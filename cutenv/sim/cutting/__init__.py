"""Law of crack growth under a driven blade, its drive and its force sensor."""
