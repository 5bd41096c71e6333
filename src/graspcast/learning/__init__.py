"""Learning to tell from the disagreement of estimators whether a grasp will succeed."""
