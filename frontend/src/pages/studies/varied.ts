/** What a study can vary: settings of its experiment and of the loop, and numbers of the plant, with symbol and unit. */

import { useQuery } from "@tanstack/react-query";
import { offered } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import { experimentKindsQuery } from "../../service/queries";
import { plantNumbersQuery } from "../../service/studies";
import { isOfTheLoop } from "../experiments/order";

export interface Varied {
  readonly name: string;
  readonly label: string;
  readonly unit: string;
  /** What a new axis or setting begins with. */
  readonly value: boolean | number | string;
}

export interface Choices {
  readonly experiment: readonly Varied[];
  readonly loop: readonly Varied[];
  readonly plant: readonly Varied[];
}

/** The choices of a study of this experiment; those of an experiment that is not known are of the loop and the plant. */
export function useVaried(experiment: string): Choices {
  const { data: kinds = [] } = useQuery(experimentKindsQuery);
  const { data: numbers = [] } = useQuery(plantNumbersQuery);
  const angles = useAngles();
  const kind = kinds.find(({ name }) => name === experiment) ?? null;
  const settings = (kind ?? kinds[0])?.settings ?? [];
  const shown = settings.map((setting) => ({
    loop: isOfTheLoop(setting),
    name: setting.name,
    label: `${setting.symbol}: ${setting.meaning}`,
    unit: setting.unit,
    value: offered(setting.default ?? "", setting, angles),
  }));
  return {
    experiment: kind === null ? [] : shown.filter(({ loop, name }) => !loop && name !== "segments"),
    loop: shown.filter(({ loop }) => loop),
    plant: numbers.map(({ name, unit, value }) => ({ name, label: name, unit, value })),
  };
}

/** One of the choices by name; what is not among them counts in SI. */
export function variedOf(choices: Choices, name: string): Varied {
  const all = [...choices.experiment, ...choices.loop, ...choices.plant];
  return all.find((one) => one.name === name) ?? { name, label: name, unit: "1", value: 0 };
}

/** The choices as groups of a select, with what stands there also where it is none of them. */
export function groupsOf(choices: Choices, current: string, only: readonly (keyof Choices)[]) {
  const titles = { experiment: "Of the experiment", loop: "Of the loop", plant: "Of the plant" };
  const groups = only.map((key) => ({
    group: titles[key],
    items: choices[key].map(({ name, label }) => ({ value: name, label })),
  }));
  const known = groups.some(({ items }) => items.some(({ value }) => value === current));
  return known ? groups : [{ group: "In the text", items: [{ value: current, label: current }] }, ...groups];
}
