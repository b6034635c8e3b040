/** What is varied or set, by name and meaning: on a line of its own, as meanings are long. */

import { NativeSelect } from "@mantine/core";
import { type Choices, groupsOf, variedOf } from "./varied";

interface VariedSelectProps {
  readonly label: string;
  readonly value: string;
  readonly choices: Choices;
  readonly only: readonly (keyof Choices)[];
  onChange(name: string): void;
}

export function VariedSelect({ label, value, choices, only, onChange }: VariedSelectProps) {
  return (
    <NativeSelect
      aria-label={label}
      title={variedOf(choices, value).label}
      style={{ flex: "1 0 100%" }}
      data={groupsOf(choices, value, only)}
      value={value}
      onChange={(event) => onChange(event.currentTarget.value)}
    />
  );
}
