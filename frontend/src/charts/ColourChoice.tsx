/** The line of a signal in the legend; opens the choice of its colour, which is remembered for the person. */

import { Popover } from "@mantine/core";
import { useState } from "react";
import { usePreferences } from "../service/preferences";
import { PALETTE, signalOf, type Trace } from "../theme/signals";
import styles from "./ColourChoice.module.css";

export function ColourChoice({ trace }: { trace: Trace }) {
  const [opened, setOpened] = useState(false);
  const { preferences, change } = usePreferences();
  const signal = signalOf(trace.name);

  function choose(hue: string | null): void {
    const { [signal]: _before, ...others } = preferences.colours;
    change({ colours: hue === null ? others : { ...others, [signal]: hue } });
    setOpened(false);
  }

  return (
    <Popover opened={opened} onChange={setOpened} position="bottom-start" withArrow trapFocus returnFocus>
      <Popover.Target>
        <button
          type="button"
          className={styles.swatch}
          aria-label={`Colour of ${trace.name}`}
          aria-expanded={opened}
          onClick={() => setOpened(!opened)}
        >
          <svg width="18" height="8" aria-hidden="true">
            <line
              x1="0"
              x2="18"
              y1="4"
              y2="4"
              stroke={trace.hue}
              strokeWidth="2.5"
              strokeDasharray={trace.dashed ? "5 3" : trace.dotted ? "2 2" : undefined}
            />
          </svg>
        </button>
      </Popover.Target>
      <Popover.Dropdown p={8}>
        <div className={styles.choices}>
          {PALETTE.map((hue) => (
            <button
              key={hue}
              type="button"
              className={styles.hue}
              style={{ background: hue }}
              aria-label={`Colour ${hue}`}
              aria-pressed={hue === trace.hue}
              onClick={() => choose(hue)}
            />
          ))}
          <button type="button" className={styles.standard} onClick={() => choose(null)}>
            Standard
          </button>
        </div>
      </Popover.Dropdown>
    </Popover>
  );
}
