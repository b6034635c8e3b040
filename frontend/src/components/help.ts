/** A box says what it is for when it is pointed at or focused, and is silent while something is typed. */

import type { FormEvent } from "react";
import { close } from "../service/explaining";
import type { Entry } from "../service/glossary";
import { explaining, type Handlers } from "./Explained";

/** Of the control itself, which keeps its place in the order of the Tab key; nothing without an entry. */
export function help(entry: Entry | undefined): Handlers {
  if (entry === undefined) return {};
  return {
    ...explaining([entry]),
    onInput: (event: FormEvent<HTMLElement>) => close(event.currentTarget),
  };
}
