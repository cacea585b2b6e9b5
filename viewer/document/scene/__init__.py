"""The object in the hand, without a window: its body, handles, grabs and saved views."""
