"""The schema of the attempt log: tables, constraints, and triggers that refuse changes."""

from __future__ import annotations

__all__ = ["APPLICATION_ID", "STATEMENTS", "TABLES", "VERSION"]

APPLICATION_ID = 0x47434C67
"""What the file's header says it is: the letters GCLg."""
VERSION = 1
"""The version of the schema, the header's ``user_version``."""

_POSE = "CHECK ({0} IS NULL OR (typeof({0}) = 'blob' AND length({0}) = {1}))"

TABLES = {
    "writer": """CREATE TABLE writer (
  seq INTEGER PRIMARY KEY,
  pid INTEGER NOT NULL,
  host TEXT NOT NULL,
  version TEXT NOT NULL,
  time_utc TEXT NOT NULL
)""",
    "frame": f"""CREATE TABLE frame (
  seq INTEGER PRIMARY KEY,
  episode TEXT NOT NULL,
  look INTEGER NOT NULL CHECK (look >= 1),
  time_utc TEXT NOT NULL,
  world_T_cam BLOB {_POSE.format("world_T_cam", 128)},
  K BLOB {_POSE.format("K", 72)},
  estimators TEXT NOT NULL,
  model TEXT,
  certificate TEXT,
  source TEXT NOT NULL,
  digest BLOB NOT NULL CHECK (length(digest) = 32),
  chain BLOB NOT NULL CHECK (length(chain) = 32)
)""",
    "estimate": f"""CREATE TABLE estimate (
  frame INTEGER NOT NULL REFERENCES frame (seq),
  estimator TEXT NOT NULL,
  number INTEGER NOT NULL,
  object_name TEXT NOT NULL,
  cam_T_obj BLOB NOT NULL {_POSE.format("cam_T_obj", 128)},
  score REAL NOT NULL,
  PRIMARY KEY (frame, estimator, number)
) WITHOUT ROWID""",
    "decision": f"""CREATE TABLE decision (
  seq INTEGER PRIMARY KEY,
  id TEXT NOT NULL UNIQUE,
  frame INTEGER NOT NULL REFERENCES frame (seq),
  instance INTEGER NOT NULL,
  object_name TEXT NOT NULL,
  action TEXT NOT NULL CHECK (action IN ('attempt', 'look again', 'abstain')),
  probability REAL CHECK (probability BETWEEN 0 AND 1),
  threshold REAL CHECK (threshold >= 0),
  guarantee TEXT,
  reason TEXT NOT NULL,
  guide TEXT,
  cam_T_obj BLOB {_POSE.format("cam_T_obj", 128)},
  world_T_obj BLOB {_POSE.format("world_T_obj", 128)},
  gripper TEXT NOT NULL,
  grasp TEXT NOT NULL,
  views INTEGER NOT NULL CHECK (views >= 0),
  looks INTEGER NOT NULL CHECK (looks >= 0),
  model TEXT,
  certificate TEXT
)""",
    "outcome": """CREATE TABLE outcome (
  seq INTEGER PRIMARY KEY,
  decision INTEGER NOT NULL UNIQUE REFERENCES decision (seq),
  decisions INTEGER NOT NULL CHECK (decisions >= decision),
  success INTEGER NOT NULL CHECK (success IN (0, 1)),
  reason TEXT,
  time_utc TEXT NOT NULL,
  digest BLOB NOT NULL CHECK (length(digest) = 32),
  chain BLOB NOT NULL CHECK (length(chain) = 32)
)""",
}
"""Table's name to the statement that makes it.

Matrices are little-endian float64, row by row. Each table's ``seq`` counts from 1 without gaps, in
the order of commits. ``digest`` is the SHA-256 of what the row holds (a frame's with its estimates
and decisions), ``chain`` that of the chain before it and of the digest. ``outcome.decisions`` is
the last decision that was there when the outcome came.
"""

_INDICES = (
    "CREATE INDEX frame_of_episode ON frame (episode, look)",
    "CREATE INDEX decision_of_frame ON decision (frame)",
)

_TRIGGERS = tuple(
    f"CREATE TRIGGER {table}_no_{change.lower()} BEFORE {change} ON {table} "
    "BEGIN SELECT RAISE(ABORT, 'the attempt log is append-only'); END"
    for table in TABLES
    for change in ("UPDATE", "DELETE")
)

STATEMENTS = (*TABLES.values(), *_INDICES, *_TRIGGERS)
"""All statements that make an empty log, in order."""
