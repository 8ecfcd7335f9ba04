"""What estimates are worth: the paper's tables and figures."""
