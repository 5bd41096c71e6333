"""What people read: the paper's tables beside ours."""
