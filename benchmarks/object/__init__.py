"""What a cloud says of itself, beside the truth of rendered scenes."""
