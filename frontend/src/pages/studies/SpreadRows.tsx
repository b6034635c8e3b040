/** Plants of a study that differ: which numbers are drawn, and how far. */

import { ActionIcon, Button, NativeSelect } from "@mantine/core";
import { TbPlus, TbX } from "react-icons/tb";
import page from "../Page.module.css";
import { NumberBox } from "./AxisRows";
import styles from "./StudyForm.module.css";
import type { Spread } from "./studyDocument";
import { VariedSelect } from "./VariedSelect";
import { type Choices, variedOf } from "./varied";

interface SpreadRowsProps {
  readonly spread: readonly Spread[];
  readonly choices: Choices;
  onChange(spread: readonly Spread[]): void;
}

export function SpreadRows({ spread, choices, onChange }: SpreadRowsProps) {
  const taken = new Set(spread.map(({ of }) => of));
  const further = ["motor.c0", "asymmetry.spring_A", ...choices.plant.map(({ name }) => name)].find(
    (name) => !taken.has(name),
  );
  return (
    <fieldset className={`${styles.group} ${page.fields}`}>
      <legend>Plants: numbers that are drawn for each</legend>
      {spread.map((one, index) => {
        const of = `of spread ${index + 1}`;
        const isRelative = one.absolute === undefined;
        const set = (part: Partial<Spread>) => onChange(spread.with(index, { ...one, ...part }));
        return (
          // biome-ignore lint/suspicious/noArrayIndexKey: a spread is its place in the list
          <fieldset key={index} className={styles.row} aria-label={`Spread ${index + 1}`}>
            <VariedSelect
              label={`Number ${of}`}
              value={one.of}
              choices={choices}
              only={["plant"]}
              onChange={(name) => set({ of: name })}
            />
            <NativeSelect
              aria-label={`Distribution ${of}`}
              data={["uniform", "normal"]}
              value={one.by ?? "uniform"}
              onChange={(event) => set({ by: event.currentTarget.value })}
            />
            <NativeSelect
              aria-label={`Width ${of}`}
              data={[
                { value: "relative", label: "of itself" },
                { value: "absolute", label: "absolute" },
              ]}
              value={isRelative ? "relative" : "absolute"}
              onChange={(event) => {
                const { relative, absolute, ...rest } = one;
                const width = event.currentTarget.value;
                onChange(spread.with(index, { ...rest, [width]: relative ?? absolute ?? 0.1 }));
              }}
            />
            <NumberBox
              label="±"
              of={of}
              unit={isRelative ? "1" : variedOf(choices, one.of).unit}
              value={isRelative ? one.relative : one.absolute}
              onChange={(value) => set(isRelative ? { relative: value } : { absolute: value })}
            />
            <ActionIcon
              variant="subtle"
              color="gray"
              aria-label={`Remove spread ${index + 1}`}
              onClick={() => onChange(spread.toSpliced(index, 1))}
            >
              <TbX size={14} />
            </ActionIcon>
          </fieldset>
        );
      })}
      <div>
        <Button
          variant="default"
          size="compact-xs"
          leftSection={<TbPlus size={13} />}
          disabled={further === undefined}
          onClick={() => further && onChange([...spread, { of: further, relative: 0.1 }])}
        >
          Add spread
        </Button>
      </div>
    </fieldset>
  );
}
