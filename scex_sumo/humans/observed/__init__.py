"""What drivers of a seed scene show of themselves in its last second."""
