"""What is drawn and where it comes from: model, camera, built-in scenes, file formats."""
