"""The version of clshade."""

VERSION = "0.1.0"
