"""What is drawn, decided once for figures, films, the page and files: trunk and surroundings."""
