import { Button, Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useId } from "react";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { Refusal } from "../../components/Refusal";
import { SignalName, ValueOrReason } from "../../components/values";
import { useLive } from "../../live/react";
import { dateTime, fixed, heading, significant } from "../../samples/format";
import { fillText } from "../../samples/texts";
import { parametersQuery, useApplyParameters, useUndoParameters } from "../../service/api/identifications";
import { useMayCommand, useWhyNoControl } from "../../service/control/control";
import type { ParameterChange, Parameters } from "../../wire/types";
import { NextMode } from "../operate/ModeCard";
import pageStyles from "../Page.module.css";
import identifyStyles from "./Identify.module.css";
import { TEXTS } from "./texts";

interface ChangeButtonProps {
  readonly children: string;
  readonly error: Error | null;
  readonly pending: boolean;
  /** Value that the refused request would have changed. */
  readonly about: unknown;
  onPress(): void;
}

function ChangeButton({ children, error, pending, about, onPress }: ChangeButtonProps) {
  const may = useMayCommand();
  const mode = useLive((live) => live.state?.mode);
  const id = useId();
  const noControl = useWhyNoControl();
  const reason =
    may === false
      ? TEXTS.changeOperators
      : (noControl ??
        (mode === "off" || mode === undefined ? null : fillText(TEXTS.changeOff, { mode: heading(mode) })));
  return (
    <>
      <Button
        variant="default"
        className={identifyStyles.act}
        aria-disabled={reason !== null}
        data-disabled={reason !== null || undefined}
        aria-describedby={id}
        loading={pending}
        onClick={() => reason === null && onPress()}
      >
        {children}
      </Button>
      <Refusal id={id} error={error} about={`${mode} ${about}`} text={reason}>
        <NextMode need="off" />
      </Refusal>
    </>
  );
}

/** Shows the changes of the active parameters that an identification would make, and the button to apply it. */
export function ApplyParameters({ estimate }: { estimate: number }) {
  const asked = useQuery(parametersQuery(estimate));
  const apply = useApplyParameters();
  const onCard = useLive((live) => ["rig", "virtual_card"].includes(live.state?.plant.kind ?? ""));
  const proposal = asked.data?.proposal;
  return (
    <section className={identifyStyles.model} aria-label={TEXTS.applySection}>
      <h3 className={identifyStyles.heading}>{TEXTS.parameterChanges}</h3>
      {asked.error && <p className={pageStyles.empty}>{asked.error.message}</p>}
      {asked.isPending && <p className={pageStyles.empty}>{TEXTS.comparing}</p>}
      {proposal && proposal.problem !== "" && (
        <p className={pageStyles.empty}>{fillText(TEXTS.problem, { problem: proposal.problem })}</p>
      )}
      {apply.data && (
        <output className={pageStyles.dim}>
          {fillText(TEXTS.versionActive, { version: apply.data.versions[0]?.number ?? "" })}{" "}
          <NextMode need="start" />
        </output>
      )}
      {proposal && proposal.problem === "" && (
        <>
          <ChangeTable label={TEXTS.proposedChanges} changes={proposal.changes} />
          <span className={pageStyles.dim}>
            {TEXTS.applyEffect}
            {onCard && ` ${TEXTS.applyEffectOnCard}`}
          </span>
          <ChangeButton
            error={apply.error}
            pending={apply.isPending}
            about={estimate}
            onPress={() => apply.mutate(estimate)}
          >
            {TEXTS.applyParameters}
          </ChangeButton>
        </>
      )}
    </section>
  );
}

interface ChangeTableProps {
  readonly label: string;
  readonly changes: readonly ParameterChange[];
}

function ChangeTable({ label, changes }: ChangeTableProps) {
  return (
    <div className={identifyStyles.scroll}>
      <Table withRowBorders={false} verticalSpacing={2} aria-label={label}>
        <Table.Thead>
          <Table.Tr>
            <Table.Th>{TEXTS.parameter}</Table.Th>
            <Table.Th className={pageStyles.number}>{TEXTS.before}</Table.Th>
            <Table.Th className={pageStyles.number}>{TEXTS.after}</Table.Th>
            <Table.Th>{TEXTS.unit}</Table.Th>
            <Table.Th className={pageStyles.number}>{TEXTS.change}</Table.Th>
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {changes.map((one) => (
            <Table.Tr key={`${one.name} ${one.side}`}>
              <Table.Td>
                <Named name={one.name} />{" "}
                {fillText(one.name.startsWith("k") ? TEXTS.ofSpring : TEXTS.ofMotor, { side: one.side })}
              </Table.Td>
              <Table.Td className={pageStyles.number}>
                <ValueOrReason value={one.before} why={TEXTS.noValueBefore}>
                  {(value) => significant(value, 5)}
                </ValueOrReason>
              </Table.Td>
              <Table.Td className={pageStyles.number}>
                <ValueOrReason value={one.after} why={TEXTS.noValueAfter}>
                  {(value) => significant(value, 5)}
                </ValueOrReason>
              </Table.Td>
              <Table.Td>{one.unit}</Table.Td>
              <Table.Td className={pageStyles.number}>
                <ValueOrReason value={one.percent} why={TEXTS.noPercent}>
                  {(percent) => `${percent > 0 ? "+" : ""}${fixed(percent, 2)}`}
                </ValueOrReason>
              </Table.Td>
            </Table.Tr>
          ))}
        </Table.Tbody>
      </Table>
    </div>
  );
}

/** Shows the name of a parameter; k0, k1, … are coefficients, the others are in the notation. */
function Named({ name }: { name: string }) {
  if (!/^k\d$/.test(name)) return <SignalName name={name} />;
  return (
    <span className="symbol">
      <i>k</i>
      <sub>{name.slice(1)}</sub>
    </span>
  );
}

const DIGEST_SHOWN = 12;

type Version = Parameters["versions"][number];

export function ParametersCard() {
  const { data, error } = useQuery(parametersQuery(null));
  const undo = useUndoParameters();
  const newest = data?.versions[0];
  return (
    <Card title={TEXTS.activeParameters}>
      {error && <p className={pageStyles.empty}>{error.message}</p>}
      {data && newest && (
        <>
          <p className={pageStyles.lead}>
            {data.name},{" "}
            {newest.number === 0 ? TEXTS.fromFile : fillText(TEXTS.version, { version: newest.number })},{" "}
            <code title={newest.digest}>{newest.digest.slice(0, DIGEST_SHOWN)}</code>
          </p>
          <div className={identifyStyles.scroll}>
            <Table aria-label={TEXTS.versions}>
              <Table.Thead>
                <Table.Tr>
                  <Table.Th>{TEXTS.versionColumn}</Table.Th>
                  <Table.Th>{TEXTS.versionTime}</Table.Th>
                  <Table.Th>{TEXTS.versionPerson}</Table.Th>
                  <Table.Th>{TEXTS.versionSource}</Table.Th>
                  <Table.Th>{TEXTS.checksum}</Table.Th>
                </Table.Tr>
              </Table.Thead>
              <Table.Tbody>
                {data.versions.map((version) => (
                  <Table.Tr key={version.number}>
                    <Table.Td>{version.number}</Table.Td>
                    <Table.Td className={identifyStyles.together}>
                      {version.at === null ? TEXTS.atStart : dateTime(version.at)}
                    </Table.Td>
                    <Table.Td>
                      <ValueOrReason value={version.who || null} why={TEXTS.noPerson}>
                        {(who) => who}
                      </ValueOrReason>
                    </Table.Td>
                    <Table.Td>
                      <Origin version={version} />
                    </Table.Td>
                    <Table.Td>
                      <code title={version.digest}>{version.digest.slice(0, DIGEST_SHOWN)}</code>
                    </Table.Td>
                  </Table.Tr>
                ))}
              </Table.Tbody>
            </Table>
          </div>
          {newest.number > 0 && (
            <section className={identifyStyles.model} aria-label={TEXTS.newestChange}>
              <h3 className={identifyStyles.heading}>
                {fillText(TEXTS.changedBy, { version: newest.number })}
              </h3>
              <ChangeTable label={TEXTS.changedParameters} changes={newest.changes} />
              <ChangeButton
                error={undo.error}
                pending={undo.isPending}
                about={newest.number}
                onPress={() => undo.mutate(newest.number)}
              >
                {fillText(TEXTS.undo, { version: newest.number })}
              </ChangeButton>
            </section>
          )}
        </>
      )}
    </Card>
  );
}

function Origin({ version }: { version: Version }) {
  const { number, run, estimate, undone } = version;
  const from =
    run !== null ? (
      <Link href={`/identify/${run}`}>{fillText(TEXTS.runLink, { run })}</Link>
    ) : estimate === null ? (
      TEXTS.parameterFile
    ) : (
      TEXTS.measuredTableSource
    );
  return undone ? (
    <>
      {TEXTS.backTo} {from}
    </>
  ) : number === 0 ? (
    TEXTS.parameterFile
  ) : (
    from
  );
}
