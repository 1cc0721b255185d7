"""What tests of several rooms share: scenes, look-alike data, damaged streams, a browser."""
