import { Button, NativeSelect, TextInput } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useId, useState } from "react";
import { TbSearch } from "react-icons/tb";
import { OperatorsOnly } from "../../components/ControlMenu";
import { Refusal } from "../../components/Refusal";
import { spacedName } from "../../samples/format";
import { fillText } from "../../samples/texts";
import { savedSearchesQuery, searchWordsQuery, useForgetSearch, useSaveSearch } from "../../service/api/runs";
import pageStyles from "../Page.module.css";
import runsStyles from "./Runs.module.css";
import { TEXTS } from "./texts";

/** Converts the filter form to a search. Pure. */

export interface Filters {
  readonly kind: string;
  readonly end: string;
  readonly verdict: string;
  readonly tag: string;
  /** Name of a station, ALL_STATIONS, or "" for the station of this service. */
  readonly station: string;
  /** Days of the local time zone, such as 2026-03-31, or "". */
  readonly from: string;
  readonly to: string;
}

export const ALL_STATIONS = "*";
/** Matches every station; without a station term, a search covers only this service's station. */
const ANY_STATION = 'station ~ ""';
export const NO_FILTERS: Filters = { kind: "", end: "", verdict: "", tag: "", station: "", from: "", to: "" };

/** Returns the form as a search; "" for an empty form. */
export function whereOf(filters: Filters): string {
  const { kind, end, verdict, tag, station, from, to } = filters;
  const terms = [
    kind && `kind = ${quoted(kind)}`,
    end && `end = ${quoted(end)}`,
    verdict && `verdict = ${quoted(verdict)}`,
    tag && `tag = ${quoted(tag)}`,
    station && (station === ALL_STATIONS ? ANY_STATION : `station = ${quoted(station)}`),
    from && `date >= ${midnight(from, 0)}`,
    to && `date < ${midnight(to, 1)}`,
  ];
  return terms.filter((term) => typeof term === "string" && term !== "").join(" ");
}

/** Returns the form and the search box as one search, to save under a name. */
export function together(typed: string, filters: Filters): string {
  const form = whereOf(filters);
  const box = typed.trim();
  return form === "" || box === "" ? box || form : `(${box}) ${form}`;
}

/** Returns the start of a day, plus `days`, in UTC.
 * Returns an invalid date unchanged, so that the service refuses it. */
function midnight(day: string, days: number): string {
  const begin = new Date(`${day}T00:00`);
  if (Number.isNaN(begin.getTime())) return day;
  begin.setDate(begin.getDate() + days);
  return begin.toISOString().slice(0, 16);
}

function quoted(text: string): string {
  return `"${text.replace(/["\\]/g, "\\$&")}"`;
}

/** Saved searches: select, save and delete. */

interface SavedSearchesProps {
  readonly typed: string;
  readonly filters: Filters;
  onChoose(text: string): void;
  onFilter(filters: Filters): void;
}

function SavedSearches({ typed, filters, onChoose, onFilter }: SavedSearchesProps) {
  const { data: saved = [] } = useQuery(savedSearchesQuery);
  const [name, setName] = useState("");
  const save = useSaveSearch();
  const forget = useForgetSearch();
  const asked = together(typed, filters);
  const chosen = saved.find((search) => search.where === asked)?.name ?? "";
  return (
    <div className={`${pageStyles.actions} ${runsStyles.saved}`}>
      <NativeSelect
        aria-label={TEXTS.savedSearches}
        value={chosen}
        disabled={saved.length === 0}
        data={[
          { value: "", label: saved.length === 0 ? TEXTS.noSavedSearches : TEXTS.chooseSearch },
          ...saved.map((search) => ({ value: search.name, label: search.name })),
        ]}
        onChange={(event) => {
          const found = saved.find((search) => search.name === event.currentTarget.value);
          if (found === undefined) return;
          onFilter(NO_FILTERS);
          onChoose(found.where);
        }}
      />
      <OperatorsOnly>
        {chosen !== "" && (
          <Button variant="default" loading={forget.isPending} onClick={() => forget.mutate(chosen)}>
            {TEXTS.deleteSearch}
          </Button>
        )}
        <TextInput
          aria-label={TEXTS.searchName}
          placeholder={TEXTS.searchNameHint}
          value={name}
          w={150}
          onChange={(event) => setName(event.currentTarget.value)}
        />
        <Button
          variant="default"
          disabled={asked === "" || name.trim() === ""}
          loading={save.isPending}
          onClick={() => save.mutate({ name: name.trim(), where: asked }, { onSuccess: () => setName("") })}
        >
          {TEXTS.saveSearch}
        </Button>
      </OperatorsOnly>
      <Refusal error={save.error ?? forget.error} about={asked + name} />
    </div>
  );
}

/** Search box, filter form and saved searches of the list of runs. */

interface RunSearchProps {
  readonly typed: string;
  readonly filters: Filters;
  /** Why the search is refused. */
  readonly error: Error | null;
  onType(text: string): void;
  onFilter(filters: Filters): void;
}

export function RunSearch({ typed, filters, error, onType, onFilter }: RunSearchProps) {
  const { data: words } = useQuery(searchWordsQuery);
  const refusal = useId();
  const set = (part: Partial<Filters>) => onFilter({ ...filters, ...part });
  const others = (words?.stations ?? []).filter((name) => name !== words?.station);
  const empty = typed === "" && Object.values(filters).every((value) => value === "");
  return (
    <>
      <search className={runsStyles.filters} aria-label={TEXTS.filters}>
        <TextInput
          className={runsStyles.box ?? ""}
          type="search"
          label={TEXTS.search}
          aria-label={TEXTS.searchRuns}
          aria-describedby={refusal}
          aria-invalid={error !== null}
          leftSection={<TbSearch size={14} />}
          value={typed}
          onChange={(event) => onType(event.currentTarget.value)}
        />
        <Choice
          label={TEXTS.kind}
          all={TEXTS.allKinds}
          known={words?.kinds}
          value={filters.kind}
          onChange={(kind) => set({ kind })}
        />
        <Choice
          label={TEXTS.status}
          all={TEXTS.anyStatus}
          known={words?.ends}
          value={filters.end}
          onChange={(end) => set({ end })}
        />
        <Choice
          label={TEXTS.verdict}
          all={TEXTS.anyVerdict}
          known={words?.verdicts}
          value={filters.verdict}
          onChange={(verdict) => set({ verdict })}
        />
        <Choice
          label={TEXTS.tag}
          all={TEXTS.anyTag}
          known={words?.tags}
          value={filters.tag}
          onChange={(tag) => set({ tag })}
          plain
        />
        {others.length > 0 && (
          <NativeSelect
            label={TEXTS.station}
            value={filters.station}
            data={[
              {
                value: "",
                label: words?.station
                  ? fillText(TEXTS.stationHere, { station: words.station })
                  : TEXTS.thisStation,
              },
              ...others.map((name) => ({ value: name || "none", label: name || TEXTS.noStation })),
              { value: ALL_STATIONS, label: TEXTS.allStations },
            ]}
            onChange={(event) => set({ station: event.currentTarget.value })}
          />
        )}
        <TextInput
          type="date"
          label={TEXTS.from}
          value={filters.from}
          onChange={(event) => set({ from: event.currentTarget.value })}
        />
        <TextInput
          type="date"
          label={TEXTS.to}
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
          {TEXTS.clear}
        </Button>
      </search>
      <Refusal id={refusal} error={error} text={error?.message} hint={TEXTS.searchHint} />
      <SavedSearches typed={typed} filters={filters} onChoose={onType} onFilter={onFilter} />
    </>
  );
}

interface ChoiceProps {
  readonly label: string;
  readonly all: string;
  readonly known: readonly string[] | undefined;
  readonly value: string;
  /** Shows the values unchanged, because a person entered them. */
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
        ...offered.map((word) => ({ value: word, label: plain ? word : spacedName(word) })),
      ]}
      onChange={(event) => onChange(event.currentTarget.value)}
    />
  );
}
