"""How the commands compute: precision, kept programs, processes side by side."""
