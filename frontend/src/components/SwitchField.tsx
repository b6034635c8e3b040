/** On or off, told at the switch when it is refused. */

import { Switch, type SwitchProps } from "@mantine/core";
import type { Entry } from "../service/glossary";
import { useRefusedInput } from "../service/refusedFields";
import { help } from "./help";

interface SwitchFieldProps extends Omit<SwitchProps, "error" | "onChange"> {
  /** Also where the value stands in what is sent, as refusals name it. */
  readonly name: string;
  /** What it is for. */
  readonly entry?: Entry | undefined;
  onChange(checked: boolean): void;
}

export function SwitchField({ entry, onChange, ...rest }: SwitchFieldProps) {
  const { ref, said } = useRefusedInput<HTMLInputElement>(rest.name);
  return (
    <Switch
      {...rest}
      {...help(entry)}
      ref={ref}
      error={said}
      aria-invalid={said !== null}
      onChange={(event) => onChange(event.currentTarget.checked)}
    />
  );
}
