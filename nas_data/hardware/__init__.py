"""Drive real arms: servo lines of Feetech and Dynamixel, the XL-320 of an Ergo Jr, and a virtual bus of both."""
