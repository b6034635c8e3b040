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
      aria-label={`Angles in ${NAMES[preferences.angles]} (${SIGNS[preferences.angles]})`}
      title={`Angles in ${NAMES[preferences.angles]}, for you alone: press for ${NAMES[other]}`}
      onClick={() => change({ angles: other })}
      w={44}
      px={0}
      fz={preferences.angles === "deg" ? 18 : undefined}
    >
      {SIGNS[preferences.angles]}
    </Button>
  );
}
