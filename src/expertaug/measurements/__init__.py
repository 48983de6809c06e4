"""Tables of measurements of your own, read, put on a grid of times, cut into chunks and divided into sets."""
