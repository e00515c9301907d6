"""Looking into images: what an image file holds, how far one is from another, and figures of both and of layers."""
