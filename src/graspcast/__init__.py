"""How likely is the grasp that a pose estimate would guide to succeed?"""
