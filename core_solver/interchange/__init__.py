"""Results of other programs in, tracks out."""
