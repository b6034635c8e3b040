/** What narrows the list of runs: one box for a search, a form for what is asked for most, searches under names. */

import { Button, NativeSelect, TextInput } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useId } from "react";
import { TbSearch } from "react-icons/tb";
import { Refusal } from "../../components/Refusal";
import { inWordsOf } from "../../samples/words";
import { searchWordsQuery } from "../../service/queries";
import { ALL_STATIONS, type Filters, NO_FILTERS } from "./filters";
import styles from "./Runs.module.css";
import { SavedSearches } from "./SavedSearches";

interface RunSearchProps {
  readonly typed: string;
  readonly filters: Filters;
  /** Why the search is refused. */
  readonly error: Error | null;
  onType(text: string): void;
  onFilter(filters: Filters): void;
}

const HINT =
  'Words, or NAME = VALUE: tag=paper overshoot_q_percent < 5 not who ~ "ana"; dates in UTC, as date >= 2026-03-31T10:30';

export function RunSearch({ typed, filters, error, onType, onFilter }: RunSearchProps) {
  const { data: words } = useQuery(searchWordsQuery);
  const refusal = useId();
  const set = (part: Partial<Filters>) => onFilter({ ...filters, ...part });
  const others = (words?.stations ?? []).filter((name) => name !== words?.station);
  const empty = typed === "" && Object.values(filters).every((value) => value === "");
  return (
    <>
      <search className={styles.filters} aria-label="Search and filters">
        <TextInput
          className={styles.box ?? ""}
          type="search"
          label="Search"
          aria-label="Search runs"
          aria-describedby={refusal}
          aria-invalid={error !== null}
          leftSection={<TbSearch size={14} />}
          value={typed}
          onChange={(event) => onType(event.currentTarget.value)}
        />
        <Choice
          label="Kind"
          all="all kinds"
          known={words?.kinds}
          value={filters.kind}
          onChange={(kind) => set({ kind })}
        />
        <Choice
          label="End"
          all="any end"
          known={words?.ends}
          value={filters.end}
          onChange={(end) => set({ end })}
        />
        <Choice
          label="Verdict"
          all="any verdict"
          known={words?.verdicts}
          value={filters.verdict}
          onChange={(verdict) => set({ verdict })}
        />
        <Choice
          label="Tag"
          all="any tag"
          known={words?.tags}
          value={filters.tag}
          onChange={(tag) => set({ tag })}
          plain
        />
        {others.length > 0 && (
          <NativeSelect
            label="Station"
            value={filters.station}
            data={[
              { value: "", label: words?.station ? `${words.station} (this one)` : "this one" },
              ...others.map((name) => ({ value: name || "none", label: name || "without a station" })),
              { value: ALL_STATIONS, label: "all stations" },
            ]}
            onChange={(event) => set({ station: event.currentTarget.value })}
          />
        )}
        <TextInput
          type="date"
          label="From"
          value={filters.from}
          onChange={(event) => set({ from: event.currentTarget.value })}
        />
        <TextInput
          type="date"
          label="To"
          value={filters.to}
          onChange={(event) => set({ to: event.currentTarget.value })}
        />
        <Button
          variant="default"
          disabled={empty}
          onClick={() => {
            onType("");
            onFilter(NO_FILTERS);
          }}
        >
          Clear
        </Button>
      </search>
      <Refusal id={refusal} error={error} text={error?.message} hint={HINT} />
      <SavedSearches typed={typed} filters={filters} onChoose={onType} onFilter={onFilter} />
    </>
  );
}

interface ChoiceProps {
  readonly label: string;
  readonly all: string;
  readonly known: readonly string[] | undefined;
  readonly value: string;
  /** Shown as it is: somebody's own word. */
  readonly plain?: boolean;
  onChange(value: string): void;
}

function Choice({ label, all, known = [], value, plain = false, onChange }: ChoiceProps) {
  const offered = value === "" || known.includes(value) ? known : [value, ...known];
  return (
    <NativeSelect
      label={label}
      value={value}
      data={[
        { value: "", label: all },
        ...offered.map((word) => ({ value: word, label: plain ? word : inWordsOf(word) })),
      ]}
      onChange={(event) => onChange(event.currentTarget.value)}
    />
  );
}
