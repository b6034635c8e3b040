/** What is driven, on every page: whether something real may move has to be seen at a glance. */

import { capital } from "../samples/words";
import type { PlantView } from "../wire/types";
import styles from "./Badge.module.css";

/** A plant of a package goes by its own name. */
const SHORT: Partial<Record<PlantView["kind"], string>> = {
  simulator: "SIM",
  rig: "RIG",
  virtual_card: "VIRTUAL CARD",
  replay: "REPLAY",
};

/** Of a package nobody knows better: it counts as real. */
const MAY_BE_REAL: readonly PlantView["kind"][] = ["rig", "package"];

/** The badge's word for a plant as runs keep its name: whether something real has moved. */
export function plantWord(name: string): string {
  const kinds: Readonly<Record<string, string>> = SHORT;
  const word = kinds[name.replaceAll(" ", "_")];
  return word === undefined ? name : `${word} (${name})`;
}

interface PlantBadgeProps {
  readonly plant: PlantView | undefined;
  readonly parameters: string | undefined;
}

export function PlantBadge({ plant, parameters }: PlantBadgeProps) {
  if (plant === undefined) {
    return (
      <span className={styles.badge} role="img" aria-label="Plant unknown" title="Plant unknown">
        ···
      </span>
    );
  }
  const name = capital(plant.name);
  return (
    <span
      className={styles.badge}
      data-real={MAY_BE_REAL.includes(plant.kind)}
      role="img"
      aria-label={name}
      title={`${capital(plant.says) || name}, parameters ${parameters}`}
    >
      {SHORT[plant.kind] ?? plant.name}
    </span>
  );
}
