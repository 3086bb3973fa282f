"""Programs of the maintainers: the pictures of the docs, and measurements that take long. Not installed."""
