"""One grasp trial: settings, scene, course and outcome."""
