"""Networks of the learned drivers, in torch.

May import arrays; what they see comes as tensors.
"""
