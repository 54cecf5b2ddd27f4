"""What the networks see, frame by frame: one protocol per modality, adapters behind it, and the model store."""
