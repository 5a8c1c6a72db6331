"""CommonRoad scenarios: maps and recorded road users. Only here: commonroad-io."""
