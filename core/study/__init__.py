"""How far the solver is from the truth, and what that costs; nothing else imports this."""
