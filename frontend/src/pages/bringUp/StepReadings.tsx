/** What the sensors say now of what matters in a step, large enough to be read from beside the machine. */

import { TbArrowDownRight, TbArrowUpRight } from "react-icons/tb";
import { Shown } from "../../components/Absent";
import { SignalName } from "../../components/SignalName";
import { useLive, useLiveStore, useNow, useSampleAge } from "../../live/react";
import { age, fixed } from "../../samples/format";
import { angleText, readingOf } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import { unitOf } from "../../theme/signals";
import { FIELDS } from "../../wire/sample.gen";
import type { BringUpStep } from "../../wire/types";
import styles from "./BringUp.module.css";
import { type Movement, movement, signalsOf } from "./readings";

const DECIMALS: Readonly<Record<string, number>> = { V: 3 };
const USUAL = 2;
const LOOK_MS = 100;

const WORDS: Record<Movement, string> = { rising: "rising", falling: "falling", still: "still", unknown: "" };

export function StepReadings({ step }: { step: BringUpStep["id"] }) {
  const store = useLiveStore();
  const angles = useAngles();
  const names = signalsOf(step);
  const period_s = useLive((live) => live.layout?.period_s ?? 0.001);
  const old_s = useSampleAge();
  useNow(LOOK_MS);
  return (
    <section className={styles.readings} aria-label="Readings" data-stale={old_s !== null}>
      <dl>
        {names.map((name, index) => {
          const unit = unitOf(name);
          const first = unit !== unitOf(names[index - 1] ?? "");
          const going = old_s === null ? movement(store.window, name, period_s) : "unknown";
          return (
            <div key={name} className={styles.reading} data-movement={going} data-first={first}>
              <dt>
                <SignalName name={symbolOf(name)} />
              </dt>
              <dd>
                <Shown value={store.window.newest(name)} why="the sensor gives no number">
                  {(value) =>
                    unit === "rad" ? angleText(value, USUAL, angles) : fixed(value, DECIMALS[unit] ?? USUAL)
                  }
                </Shown>{" "}
                <small>{readingOf(unit, angles).unit}</small>
              </dd>
              <dd className={styles.movement}>
                {going === "rising" && <TbArrowUpRight size={15} aria-hidden="true" />}
                {going === "falling" && <TbArrowDownRight size={15} aria-hidden="true" />}
                {WORDS[going]}
              </dd>
            </div>
          );
        })}
      </dl>
      {old_s !== null && <p className={styles.old}>As it was {age(1000 * old_s)} ago</p>}
    </section>
  );
}

function symbolOf(name: string): string {
  return FIELDS.find((field) => field.name === name)?.symbol ?? name;
}
