"""The fault campaign: every row of docs/safety.md, in the phases in which it matters, judged by the world."""
