/** Texts of the page Bring-up. */
export const TEXTS = {
  title: "Bring-up",
  loading: "Loading…",

  drives: "Drives",
  drivesOn: "Drives on.",
  drivesOff: "Drives off.",
  drivesLeft:
    "{person} switched the drives off on {time}, before this service started: someone may still be working at the rig.",
  whileOn: "Stand clear of the rig. Switch the drives off before you reach in.",
  whileLocked:
    "The motors can be turned by hand, and no motion can start. Stand clear before switching the drives on.",
  untilReset: "Reset switches the drives on again. Switch them off afterwards, before you reach in.",
  switchOn: "Switch drives on",
  switchOff: "Switch drives off",

  steps: "Steps",
  outline:
    "On a rig, this page guides you through commissioning, from drives off to a joint that is ready to run:",
  outlineSensors: "With drives off, each sensor is turned or pulled by hand and its reading is checked.",
  outlineForces: "The load cells are tared and calibrated with known weights.",
  outlineEncoders: "The encoders are zeroed at a known joint position, set by hand or by the end switch.",
  outlineMotors: "Each motor is driven briefly and its direction is checked.",
  outlinePretension:
    "Pretension is applied to the tendons, and the safety module is tested: it must disable the motors.",
  rigPage: "The rig",
  rigPageAfter: "explains what each step verifies. The virtual card allows the same steps without hardware.",
  allDone: "All {count} steps complete.",
  someDone: "{done} of {count} steps complete.",
  aboutSteps: "Each step can be cancelled. Its result is saved with person and time.",
  asViewer: "Signed in as viewer. You can observe and press STOP.",
  stepList: "Bring-up steps",

  stepTitle: "{number}. {title}",
  never: "To do",
  current: "Done",
  outOfDate: "Out of date",
  failed: "Failed",
  running: "In progress",

  readings: "Readings",
  noReading: "invalid sensor reading (NaN)",
  rising: "rising",
  falling: "falling",
  still: "steady",
  lastReading: "Last reading, {age} old",

  start: "Start",
  repeat: "Repeat",
  startStep: "{action} {step}",
  notANumber: "Enter a number in each field.",
  stepRunning: "{step} in progress",
  progress: "Progress",
  whatToDo: "What to do now",
  confirmSimulates: "On this virtual card, Confirm simulates this action.",
  confirm: "Confirm",
  cancel: "Cancel",

  result: "Result",
  personAndTime: "{person}, {time}",
} as const;
