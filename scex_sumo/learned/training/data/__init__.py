"""Training data: samples made from recordings, and batches of them as tensors."""
