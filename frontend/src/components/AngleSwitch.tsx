/** The unit in which this person reads and types angles, everywhere. */

import { Button } from "@mantine/core";
import { usePreferences } from "../service/preferences";

const NAMES = { deg: "degrees", rad: "radians" } as const;
const SIGNS = { deg: "°", rad: "rad" } as const;

export function AngleSwitch() {
  const { preferences, change } = usePreferences();
  const other = preferences.angles === "deg" ? "rad" : "deg";
  return (
    <Button
      variant="subtle"
      color="gray"
      size="compact-sm"
      aria-label={`Angles in ${NAMES[preferences.angles]}: ${SIGNS.deg} / ${SIGNS.rad}`}
      title={`Angles in ${NAMES[preferences.angles]}, for you alone: press for ${NAMES[other]}`}
      onClick={() => change({ angles: other })}
      px={4}
      fw={400}
    >
      {(["deg", "rad"] as const).map((unit, index) => (
        <span key={unit}>
          {index > 0 && "\u00a0/\u00a0"}
          {unit === preferences.angles ? <strong>{SIGNS[unit]}</strong> : SIGNS[unit]}
        </span>
      ))}
    </Button>
  );
}
