"""The laws of an alloy, with sources, and the tables made from them."""
