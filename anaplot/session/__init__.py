"""An operator's work as events, and the state that is a fold over them."""
