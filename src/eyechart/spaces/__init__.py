"""The only room that knows what an action is: how a reply is read, how far two actions differ, and their reflection."""
