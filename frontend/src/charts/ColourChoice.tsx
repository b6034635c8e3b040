/** The line of a signal in the legend; opens the choice of its colour, which is remembered for the person. */

import { Popover } from "@mantine/core";
import { useState } from "react";
import { usePreferences } from "../service/preferences";
import { PALETTE, paintOf, signalOf, type Trace } from "../theme/signals";
import styles from "./ColourChoice.module.css";
import { TraceLine } from "./TraceLine";

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
          <TraceLine trace={trace} />
        </button>
      </Popover.Target>
      <Popover.Dropdown p={8}>
        <div className={styles.choices}>
          {PALETTE.map((hue) => (
            <button
              key={hue}
              type="button"
              className={styles.hue}
              style={{ background: paintOf(hue) }}
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
