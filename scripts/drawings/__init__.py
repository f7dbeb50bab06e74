"""Programs that draw the pictures of the documentation, and the figures of the thesis anew."""
