"""The Gymnasium environments; the only room of the package that knows Gymnasium."""
