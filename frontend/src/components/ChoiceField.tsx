/** One of a few words, told at the field when it is refused. */

import { NativeSelect, type NativeSelectProps } from "@mantine/core";
import type { Entry } from "../service/glossary";
import { useRefusedInput } from "../service/refusedFields";
import { help } from "./help";

interface ChoiceFieldProps extends Omit<NativeSelectProps, "error" | "onChange"> {
  /** Where the value stands in what is sent, as refusals name it; the name of the field if left out. */
  readonly place?: string;
  /** Where there is no room below the field: the element that says why it is refused. */
  readonly saidAt?: string;
  /** What it is for. */
  readonly entry?: Entry | undefined;
  onChange(value: string): void;
}

export function ChoiceField(props: ChoiceFieldProps) {
  const { place = props.name, saidAt, entry, onChange, ...rest } = props;
  const { ref, said } = useRefusedInput<HTMLSelectElement>(place, saidAt);
  return (
    <NativeSelect
      {...rest}
      {...help(entry)}
      ref={ref}
      inputWrapperOrder={["label", "input", "description", "error"]}
      error={saidAt === undefined ? said : said !== null}
      onChange={(event) => onChange(event.currentTarget.value)}
    />
  );
}
